"""What must not be overlooked: a lost engine, a fault, contact, the end of a run."""
