"""Recordings in and out: rosbag2, ULog, DataFlash and .mat files."""
