"""The two-stage batch estimator of Sun and Gebre-Egziabher (2020), "the two-stage paper" of docs/references.md.

Begin at ``estimate.estimate``. Whole numbers such as (19) are equations of that paper, here and in ``calibration``.
"""
