"""The experiments of the paper (Ottenhaus et al. 2016), repeated with many seeds."""
