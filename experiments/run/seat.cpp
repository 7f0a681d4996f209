#include "experiments/run/seat.h"

#include <sys/mman.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <new>

#include "experiments/run/child.h"

namespace palpate::experiments {
namespace {

/// Memory that a forked process shares with this one.
class SharedMemory {
 public:
  explicit SharedMemory(std::size_t bytes) : bytes_(bytes) {
    data_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (data_ == MAP_FAILED) throw std::bad_alloc();
  }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  ~SharedMemory() { ::munmap(data_, bytes_); }
  /// The next `count` of them, made anew.
  template <class T>
  std::span<T> take(std::size_t count) {
    used_ = (used_ + alignof(T) - 1) / alignof(T) * alignof(T);
    T* first = reinterpret_cast<T*>(static_cast<std::byte*>(data_) + used_);
    used_ += count * sizeof(T);
    std::uninitialized_default_construct_n(first, count);
    return {first, count};
  }
  static std::size_t bytes_for(std::size_t frames) {
    constexpr std::size_t kSlack = 1024;  // alignment
    return frames * (sizeof(render::Frame) + 1 + sizeof(trace::FrameSpanTime) + sizeof(std::uint32_t)) +
           2 * sizeof(trace::PacedStatistics) + kSlack;
  }

 private:
  void* data_;
  std::size_t bytes_, used_ = 0;
};

}  // namespace

struct Seat::State {
  SharedMemory memory;
  Answers answers;
  Work work;
  Child child;

  State(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
        const RunOptions& options, bool apart)
      : memory(SharedMemory::bytes_for(stage.path.size())),
        answers{memory.take<render::Frame>(stage.path.size()), memory.take<std::uint8_t>(stage.path.size()),
                memory.take<trace::FrameSpanTime>(stage.path.size()),
                memory.take<std::uint32_t>(stage.path.size()),
                std::span<trace::PacedStatistics, 2>(memory.take<trace::PacedStatistics>(2))},
        work(stage, request, registry, options, answers),
        child([this](std::uint64_t task,
                     Progress& progress) { return work(static_cast<Task>(task), progress); },
              apart) {}
};

Seat::Seat(const Stage& stage, const RendererRequest& request, const render::Registry& registry,
           const RunOptions& options, bool apart)
    : state_(std::make_unique<State>(stage, request, registry, options, apart)) {}
Seat::~Seat() = default;

Result<std::string> Seat::ask(Task task, Progress& progress) {
  return state_->child.ask(static_cast<std::uint64_t>(task), progress);
}
const Answers& Seat::answers() const {
  return state_->answers;
}
bool Seat::is_apart() const {
  return state_->child.is_apart();
}

bool has_room() {
  constexpr double kLeastFree = 1.0 / 3.0;
  std::ifstream file("/proc/meminfo");
  double total = 0.0, available = 0.0;
  for (std::string line; std::getline(file, line);) {
    if (line.rfind("MemTotal:", 0) == 0)
      total = std::strtod(line.c_str() + std::strlen("MemTotal:"), nullptr);
    if (line.rfind("MemAvailable:", 0) == 0)
      available = std::strtod(line.c_str() + std::strlen("MemAvailable:"), nullptr);
  }
  return !(total > 0.0) || available > kLeastFree * total;
}

}  // namespace palpate::experiments
