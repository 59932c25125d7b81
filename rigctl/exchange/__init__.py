"""Recordings from elsewhere into sessions, and sessions into the formats of others."""
