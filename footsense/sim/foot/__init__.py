"""What rubber, temperature and fabrication do to a simulated foot."""
