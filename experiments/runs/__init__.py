"""The life of a run: files, records, pictures, workers."""
