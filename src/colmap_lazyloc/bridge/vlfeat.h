#pragma once

// VLFeat's headers, which COLMAP's sources and an installed COLMAP have in different places.
#if __has_include("thirdparty/VLFeat/sift.h")
#include "thirdparty/VLFeat/mathop.h"
#include "thirdparty/VLFeat/sift.h"
#else
#include <colmap/thirdparty/VLFeat/mathop.h>
#include <colmap/thirdparty/VLFeat/sift.h>
#endif
