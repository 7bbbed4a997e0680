"""Studies of estimators by grasp success: definition, trials, results, comparison."""

from lis_grasp_studies.harness.rows import Job
from lis_grasp_studies.harness.runner import LocalPool
from lis_grasp_studies.study.comparison import Comparison, compare
from lis_grasp_studies.study.figures import epsilon_against_truth
from lis_grasp_studies.study.results import StudyResults
from lis_grasp_studies.study.run import run_trial
from lis_grasp_studies.study.study import Study, load_study
from lis_grasp_studies.study.trial import Setup, Trial

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
