"""The virtual finger: person, skin, tracker, board and faults."""
