"""From a function of tensors to torch.fx graphs of its operations, and of its derivative's."""
