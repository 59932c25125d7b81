"""The guided way from wired parts to the first trial: each part is checked alone first."""
