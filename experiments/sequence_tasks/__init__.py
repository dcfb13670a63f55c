"""Tasks for sequence models: what is shown, what is asked, how it is judged."""
