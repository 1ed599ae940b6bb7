#pragma once

#include "colmap_lazyloc/scene/stage_timer.h"  // IWYU pragma: export
