"""The Adroit hand's tasks, and the tables of their study."""
