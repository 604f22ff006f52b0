"""Sessions: the flight tick by tick in real time, its episodes, and what is recorded of them."""
