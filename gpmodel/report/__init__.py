"""Pages and pictures of saved results."""
