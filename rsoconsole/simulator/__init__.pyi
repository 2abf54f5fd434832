from .launch import start_observatory as start_observatory
