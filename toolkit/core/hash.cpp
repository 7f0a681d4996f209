#include "toolkit/core/hash.h"

#include <fmt/ranges.h>
#include <nettle/sha2.h>

#include <array>
#include <cstdint>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/files.h"

namespace palpate {
namespace {

class Sha256 {
 public:
  Sha256() noexcept { sha256_init(&context_); }
  void add(std::span<const std::byte> data) noexcept {
    sha256_update(&context_, data.size(),
                  reinterpret_cast<const std::uint8_t*>(data.data()));  // NOLINT: bytes are bytes
  }
  [[nodiscard]] std::string digits() noexcept {
    std::array<std::uint8_t, SHA256_DIGEST_SIZE> digest{};
    sha256_digest(&context_, digest.size(), digest.data());
    return fmt::format("{:02x}", fmt::join(digest, ""));
  }

 private:
  sha256_ctx context_;
};

}  // namespace

std::string Hash64::hex() const {
  return fmt::format("{:016x}", state_);
}

std::string sha256_of(std::span<const std::byte> data) noexcept {
  Sha256 hash;
  hash.add(data);
  return hash.digits();
}

Result<std::string> sha256_of_file(const std::string& path) {
  PALPATE_ASSIGN(InputFile file, InputFile::open(path));
  Sha256 hash;
  std::vector<std::byte> piece(1u << 20);
  while (true) {
    PALPATE_ASSIGN(const std::size_t got, file.read(piece));
    if (got == 0) return hash.digits();
    hash.add(std::span(piece).first(got));
  }
}

}  // namespace palpate
