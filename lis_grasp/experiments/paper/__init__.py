"""The experiments of the paper (Ottenhaus et al. 2016), again and from seeds."""
