"""The environments as Gymnasium's single and vector ones."""
