"""Analyse sessions: features, classifiers, the paper's tasks, figures and reports."""
