"""Sweeps: thousands of cloths, labelled, resumable, on one machine or a cluster."""
