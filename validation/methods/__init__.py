"""The methods: what each approximation errs by and costs, and where it fails, against converged float64 references."""
