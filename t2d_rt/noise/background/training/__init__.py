"""Training of background models; needs torch and vector-quantize-pytorch, the extra [learn]."""
