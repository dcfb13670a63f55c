"""The memory less one part each, where it pays: online regression, an arm, recall."""
