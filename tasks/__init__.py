"""One task per operation: cache key, retries, timeouts, resource limits and logging."""
