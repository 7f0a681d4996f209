// palpate-reconstruct: one reconstruction in a process that can be stopped and limited. Started by
// run_limited(); ends with its parent.
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <new>
#include <string>

#include <palpate/result.h>
#include "baselines/reconstruct/method_functions.h"
#include "baselines/reconstruct/reconstruct.h"
#include "baselines/reconstruct/reconstruction.h"

namespace palpate::baselines {
namespace {

constexpr int kSocket = STDIN_FILENO;
constexpr int kExitFailed = 1, kExitUsage = 2;

bool send_all(std::string_view bytes) noexcept {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(kSocket, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

void send_message(WorkerMessage kind, std::string_view bytes) noexcept {
  std::array<char, kMessageHead> head{static_cast<char>(kind)};
  const std::uint64_t size = bytes.size();
  std::memcpy(head.data() + 1, &size, sizeof size);
  if (send_all({head.data(), head.size()})) send_all(bytes);
}

/// This handler allocates nothing: memory is exhausted.
[[noreturn]] void out_of_memory() {
  send_message(WorkerMessage::kNoMemory, {});
  std::_Exit(kExitFailed);
}

class SendProgress final : public Progress {
 public:
  void report(std::string_view what, double) override { send_message(WorkerMessage::kProgress, what); }
};

bool read_all(char* to, std::size_t size) {
  while (size > 0) {
    const ssize_t got = ::read(kSocket, to, size);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    to += got;
    size -= static_cast<std::size_t>(got);
  }
  return true;
}

Result<cloud::Cloud> receive_cloud() {
  std::uint64_t size = 0;
  std::string bytes;
  if (read_all(reinterpret_cast<char*>(&size), sizeof size)) {
    bytes.resize(size);
    if (!read_all(bytes.data(), bytes.size())) bytes.clear();
  }
  InputArchive reader(bytes);
  return read_cloud(reader);
}

/// VmHWM covers this program only; getrusage would include what ran before exec.
std::size_t peak_bytes() {
  constexpr std::size_t kKibi = 1024;
  std::ifstream status("/proc/self/status");
  std::string word;
  while (status >> word)
    if (std::size_t kilobytes = 0; word == "VmHWM:" && status >> kilobytes) return kilobytes * kKibi;
  return 0;
}

Result<Reconstruction> work(const std::string& name, int threads, int argc, char** argv) {
  PALPATE_ASSIGN(const Method* const method, find_method(name));
  Options given;
  for (int i = 0; i < argc; ++i) {
    const std::string_view option = argv[i];
    const std::size_t equals = option.find('=');
    if (equals == std::string_view::npos) return Error{fmt::format("'{}' is no option", option)};
    given.set(std::string(option.substr(0, equals)), std::string(option.substr(equals + 1)));
  }
  PALPATE_ASSIGN(const Options options, validate(given, method->options, name));
  PALPATE_ASSIGN(const cloud::Cloud cloud, receive_cloud());
  SendProgress progress;
  Reconstruction made;
  render::PreparePhases phases(made.made, {threads, &progress});
  PALPATE_ASSIGN(made.mesh, make_mesh(*method, cloud, options, threads, phases));
  made.threads = threads;
  made.made_on = now_text();
  made.peak_bytes = peak_bytes();
  return made;
}

int run(int argc, char** argv) {
  if (argc < 1 + kWorkerFixedArguments) {
    std::fputs("palpate-reconstruct is started by palpate; by itself it does nothing\n", stderr);
    return kExitUsage;
  }
  // Only the socket carries messages; library output is kept for an error.
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != std::atoi(argv[4])) return kExitFailed;  // the parent ended before the line above
  if (const auto limit = static_cast<rlim_t>(std::strtoull(argv[3], nullptr, 10)); limit > 0) {
    const rlimit data{limit, limit};
    ::setrlimit(RLIMIT_DATA, &data);
  }
  const rlimit no_core{0, 0};  // crashes are reported without a core file
  ::setrlimit(RLIMIT_CORE, &no_core);
  std::set_new_handler(out_of_memory);
  const Result<Reconstruction> made =
      work(argv[1], std::atoi(argv[2]), argc - 1 - kWorkerFixedArguments, argv + 1 + kWorkerFixedArguments);
  OutputArchive writer;
  if (made)
    write(writer, *made);
  else
    write(writer, made.error());
  send_message(made ? WorkerMessage::kResult : WorkerMessage::kError, writer.bytes());
  std::fflush(nullptr);
  // Skips destructors of hundreds of megabytes.
  std::_Exit(made ? 0 : kExitFailed);
}

}  // namespace
}  // namespace palpate::baselines

int main(int argc, char** argv) {
  try {
    return palpate::baselines::run(argc, argv);
  } catch (const std::exception& failure) {
    std::fprintf(stderr, "%s\n", failure.what());
    return palpate::baselines::kExitFailed;
  }
}
