"""A plan of days with faults and kills, kills at random instants, every fault in every state."""
