"""Parts of the study of reaching with a fixed arm: what its policies do once they have arrived."""
