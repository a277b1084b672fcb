"""Study `touchdown`: latency from a foot's touchdown to the first frame that reports contact."""
