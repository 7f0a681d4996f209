// The atomic writer lives in core, where trace can use it too; here under io's name.
#pragma once

#include "toolkit/core/atomic_file.h"

namespace palpate::io {

using palpate::AtomicFile;
using palpate::write_file;

}  // namespace palpate::io
