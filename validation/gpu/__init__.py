"""Whether the kernels give on a GPU what they give on a CPU, and how fast."""
