"""Sections of the report: each module collects the data of one section."""
