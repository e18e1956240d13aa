"""What experiments share: the row, processes, recordings with their references, matching, and peers."""
