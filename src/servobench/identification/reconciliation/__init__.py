"""Why figures differ: causes weighed against the difference between data, data sheets and what somebody claims."""
