"""The command line: composed and checked before Hydra makes a folder."""
