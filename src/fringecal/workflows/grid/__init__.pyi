from .report import (
    GridPicture as GridPicture,
)
from .report import (
    distortion_section as distortion_section,
)
from .report import (
    distortion_sentences as distortion_sentences,
)
from .report import (
    distortion_size as distortion_size,
)
from .report import (
    grid_sentence as grid_sentence,
)
from .report import (
    lines_section as lines_section,
)
from .report import (
    scale_section as scale_section,
)
