"""Studies: does a better surface give a better grasp? Trials, their results, what they say."""

from lis_grasp.experiments.study.comparison import Comparison, compare
from lis_grasp.experiments.study.study import Setup, Study, Trial
from lis_grasp.experiments.study.study_file import load_study
from lis_grasp.experiments.study.study_results import StudyResults

__all__ = ["Comparison", "Setup", "Study", "StudyResults", "Trial", "compare", "load_study"]
