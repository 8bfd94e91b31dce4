"""One module for each way in which others keep hand poses; each ends with its `FORMAT`."""
