"""The two-stage batch estimator of Sun and Gebre-Egziabher ("the two-stage paper"); begin at ``estimate.estimate``."""
