"""Wide evaluation of estimators: many shapes, contact sets and levels of noise."""
