"""Estimators on plain arrays, one per file, that know nothing of aeroplanes."""
