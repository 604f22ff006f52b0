"""What several studies share: reports and their pages, records of finished stages, demonstrations and trainings."""
