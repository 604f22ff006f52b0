"""What a stranger's file or folder can do to whoever opens it: nothing but be refused."""
