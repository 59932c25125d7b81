"""The runner: a plan step by step, trial by trial, with pauses and verdicts."""
