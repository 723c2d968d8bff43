"""A first look at a video, in seconds: will it do, and what to film differently."""
