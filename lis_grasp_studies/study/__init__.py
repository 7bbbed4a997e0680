"""Studies of estimators by grasp success: definition, trials, results, comparison."""
