"""Studies of estimators by grasp success: definition, trials, results, comparison."""

from lis_grasp_studies.runner import LocalPool
from lis_grasp_studies.study.comparison import Comparison, compare
from lis_grasp_studies.study.study import Study, load_study
from lis_grasp_studies.study.study_figures import epsilon_against_truth
from lis_grasp_studies.study.study_results import StudyResults
from lis_grasp_studies.study.study_trial import run_trial
from lis_grasp_studies.study.trial import Setup, Trial
from lis_grasp_studies.trial_results import Job

__all__ = [
    "Comparison",
    "Job",
    "LocalPool",
    "Setup",
    "Study",
    "StudyResults",
    "Trial",
    "compare",
    "epsilon_against_truth",
    "load_study",
    "run_trial",
]
