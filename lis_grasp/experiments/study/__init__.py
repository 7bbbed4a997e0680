"""Studies of estimators by grasp success: definition, trials, results, comparison."""

from lis_grasp.experiments.study.comparison import Comparison, compare
from lis_grasp.experiments.study.study import Setup, Study, Trial, load_study
from lis_grasp.experiments.study.study_results import StudyResults

__all__ = ["Comparison", "Setup", "Study", "StudyResults", "Trial", "compare", "load_study"]
