"""Flights that come as tables of other people's columns: CSV, Parquet, HDF5, MAT, Excel (docs/import.md)."""
