"""Reads tables that runs wrote and makes tables and figures of them; knows no torch."""
