"""Classifiers of micro-Doppler spectrograms: models, training, evaluation and benchmarks. Most of it needs the extra [learn]."""
