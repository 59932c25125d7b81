"""Trials from the left edge on, with earlier ones of the same condition behind them."""
