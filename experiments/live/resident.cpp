#include "experiments/live/resident.h"

#include <malloc.h>
#include <unistd.h>

#include <fstream>

namespace palpate::experiments {

std::uint64_t resident_bytes() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  std::uint64_t pages = 0, in_memory = 0;
  file >> pages >> in_memory;
  return in_memory * static_cast<std::uint64_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace palpate::experiments
