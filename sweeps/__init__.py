"""Specs, runner, store, metrics, leaderboard, report and the command line."""
