"""The jobs ``log history``, ``log compare`` and ``log page``: runs that have ended, from their logs."""
