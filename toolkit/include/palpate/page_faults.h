// Page faults of a thread: a frame that waits for the system's memory shows here and nowhere else. A header
// of its own, since servo loops and replays share it and clocks do not need it.
//
// First:
//   const palpate::PageFaults before = palpate::thread_page_faults();
//   const render::Frame frame = renderer->step(hip_mm, 0.0);
//   const palpate::PageFaults faults = palpate::thread_page_faults() - before;  // 0 and 0
#pragma once

#include <cstdint>

namespace palpate {

/// Pages that a thread met for the first time (minor), or that were read from disk (major).
struct PageFaults {
  std::uint64_t minor = 0, major = 0;
  PageFaults& operator+=(const PageFaults& more) noexcept {
    minor += more.minor;
    major += more.major;
    return *this;
  }
  PageFaults operator-(const PageFaults& before) const noexcept {
    return {minor - before.minor, major - before.major};
  }
};

/// Of the calling thread since it began; 0 where the system does not tell. One system call.
[[nodiscard]] PageFaults thread_page_faults() noexcept;

}  // namespace palpate
