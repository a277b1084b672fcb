"""Effects of rubber, temperature and fabrication on a simulated foot."""
