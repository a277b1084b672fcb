"""Study `touchdown`: latency from the touchdown of a foot to the frame that reports it."""
