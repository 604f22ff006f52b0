"""What people look at: films, drawings, pages, recordings for rerun, figures, and the documentation."""
