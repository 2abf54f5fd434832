from .camera_device import CameraDevice as CameraDevice
from .camera_device import SceneLike as SceneLike
from .clock_device import ClockDevice as ClockDevice
from .mount_device import MountDevice as MountDevice
from .virtual_clock import VirtualClock as VirtualClock
from .weather_and_dome import DomeDevice as DomeDevice
from .weather_and_dome import Schedule as Schedule
from .weather_and_dome import WeatherDevice as WeatherDevice
