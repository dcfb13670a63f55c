"""What an ensemble came to: a line a rollout, a summary, a histogram."""
