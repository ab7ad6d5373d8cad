"""Make motions from recorded clips that are chosen, warped, mirrored, bent, blended and chained, with feet that stay planted."""
