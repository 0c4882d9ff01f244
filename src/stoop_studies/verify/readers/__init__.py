"""Readers of logs under damage: every case ends in an error of ours, or in a recording that says what was wrong."""
