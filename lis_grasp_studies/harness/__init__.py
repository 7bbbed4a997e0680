"""One harness for all experiments: trials, rows, runners, statistics, tables and pages."""
