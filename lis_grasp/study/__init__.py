"""Studies: does a better surface give a better grasp? Trials, their results, what they say."""

from lis_grasp.study.comparison import Comparison, compare
from lis_grasp.study.results import StudyResults
from lis_grasp.study.study import Setup, Study, Trial
from lis_grasp.study.study_file import load_study

__all__ = ["Comparison", "Setup", "Study", "StudyResults", "Trial", "compare", "load_study"]
