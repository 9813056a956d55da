from hypothesis import settings

settings.register_profile("control", deadline=None)
settings.load_profile("control")
