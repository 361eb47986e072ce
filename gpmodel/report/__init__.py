"""Text, pages and pictures of saved results."""
