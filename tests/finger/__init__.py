"""Tests of the moving finger's experiment."""
