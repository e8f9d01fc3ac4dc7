"""Jobs of many steps: worker processes, tasks that wait for one another, finished steps kept on disk."""
