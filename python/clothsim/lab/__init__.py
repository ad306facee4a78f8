"""Evidence: the paper's experiments, the bench, peers, contact figures, hard cases."""
