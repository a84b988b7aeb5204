"""S3G: motion controller behind two serial ports."""
