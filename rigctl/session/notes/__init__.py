"""Notes on a session and verdicts on its trials that people add later, in dated files."""
