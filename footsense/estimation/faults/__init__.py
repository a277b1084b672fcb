"""Which elements and legs can be used: status, consistency, imputation, calibration monitor."""
