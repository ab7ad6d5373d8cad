"""What the samples of a real radar hold beside echoes."""
