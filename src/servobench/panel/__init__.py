"""The front panel: a page in a browser from which a motor is driven, seen, recorded and identified."""
"""The front panel: a page from which a person drives the motor, sees it live, records, identifies and reads the result."""
