"""Pictures of flights: the scene drawn for people, films with captions, clips, MuJoCo's own window."""
