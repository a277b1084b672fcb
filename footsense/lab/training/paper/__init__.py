"""The paper's networks: plain perceptrons trained by RPROP on the 362 cases, one scan as input."""
