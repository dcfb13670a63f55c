"""Every engine measured, a section a file."""
