"""The job ``opcua``: state, figures and alarms of a current run for the plant, over OPC UA, from the run's snapshot."""
