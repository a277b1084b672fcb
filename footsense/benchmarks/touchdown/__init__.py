"""Study `touchdown`: latency from the touchdown of a foot to the first frame that reports contact."""
