"""Makes synthetic scenes for tests and benchmarks; needs scipy."""
