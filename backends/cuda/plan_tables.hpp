// SPDX-License-Identifier: Apache-2.0
#pragma once
#include <cstddef>
#include <vector>

#include "device/operations.hpp"

namespace cama {

/// Where the slots of a plan's batches lie in one block of memory, which is copied to the device at once. The slots of
/// a batch are rows, one for each world. Slots that refer to memory of the host refer to the block instead: uploads to
/// their data in it, downloads to their place among all that is downloaded.
class PlanTables {
public:
  explicit PlanTables(const Plan &plan);

  struct Table {
    std::size_t offset = 0;   ///< bytes from the start of the block
    std::size_t data = 0;     ///< of an upload: offset of its data; of a download: its first byte of all
    std::size_t bounds = 0;   ///< of a sort: offset of [worlds + 1] ints, first key of each world
    int items = 0;            ///< of a sort: keys of all worlds
    int largest = 0;          ///< largest first slot
  };
  const Table &table(int batch) const { return tables_[static_cast<std::size_t>(batch)]; }
  std::size_t bytes() const { return bytes_; }
  std::size_t downloaded_bytes() const { return downloaded_; }

  /// Writes all tables. device: where the block will be; downloads: where what is downloaded is gathered.
  void write(unsigned char *block, unsigned char *device, unsigned char *downloads);
  /// Hands what was downloaded to the worlds.
  void deliver(const unsigned char *downloaded) const;

private:
  void place(int batch);
  void write(int batch, unsigned char *block, unsigned char *device, unsigned char *downloads);

  const Plan &plan_;
  std::vector<Table> tables_;
  std::size_t bytes_ = 0, downloaded_ = 0;
};

}  // namespace cama
