"""The page's server: who looks, what is said, and the pictures on their way."""
