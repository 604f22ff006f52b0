"""Parts of the study of flight control: who flies, and manoeuvres by which laws and policies are compared."""
