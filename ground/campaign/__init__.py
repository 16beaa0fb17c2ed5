"""Campaigns: many independent cases on all cores or a cluster, resumable, the same whatever the number of workers."""
