"""Measurements of speed and memory; `make speed`."""
