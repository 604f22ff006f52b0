"""Documentation: the pages of the repository and the reference of its code as one site that opens offline."""
