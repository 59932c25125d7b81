"""Recording while the drum is operated by hand."""
