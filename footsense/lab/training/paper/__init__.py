"""The paper's networks: plain perceptrons, one scan as input, trained by RPROP on 362 load cases."""
