// The sites around points: which the second stage pools.

#include <algorithm>
#include <cstdint>
#include <vector>

#include "tasks.h"

namespace {

// Keys (*b, n), points xyz (*b, q, 3) in metres and their cells zyx (*b, q, 3) -> the first `s` sites within the radius
// (*b, q, s), of which those that lack repeat the first, and how many there are (*b, q). Looked at are lines of cells at
// `lines` (dz, dy) from a point's own, and along them `reach` cells to either side. Sizes and corner are x, y, z.
ffi::Error Query(ffi::ThreadPool pool, Integers keys, Floats points, Integers cells, Numbers shape, Numbers lines,
                 int64_t reach, float radius_squared, ffi::Span<const float> size, ffi::Span<const float> corner,
                 ffi::ResultBuffer<ffi::S32> result, ffi::ResultBuffer<ffi::S32> number) {
  const int64_t batch = Batch(keys.dimensions(), 1), n = Last(keys.dimensions(), 1);
  const int64_t q = Last(points.dimensions(), 2), s = Last(result->dimensions(), 1), blocks = Blocks(q);
  const int64_t planes = shape[0], rows = shape[1], columns = shape[2];
  // Where each line's sites begin, so that a search goes no further than one line.
  const int64_t all = planes * rows;
  std::vector<int32_t> begins(batch * (all + 1));
  Parallel(pool, batch, [&](int64_t sample) {
    const int32_t* const key = keys.typed_data() + sample * n;
    int64_t at = 0;
    for (int64_t line = 0; line <= all; ++line) {
      while (at < n && key[at] < line * columns) ++at;
      begins[sample * (all + 1) + line] = static_cast<int32_t>(at);
    }
  });
  Parallel(pool, batch * blocks, [&](int64_t task) {
    const int64_t sample = task / blocks, first = task % blocks * kBlock, last = std::min(first + kBlock, q);
    const int32_t* const key = keys.typed_data() + sample * n;
    const int32_t* const begin = begins.data() + sample * (all + 1);
    for (int64_t point = sample * q + first; point < sample * q + last; ++point) {
      const float* const xyz = points.typed_data() + 3 * point;
      const int32_t* const cell = cells.typed_data() + 3 * point;
      int32_t* const found = result->typed_data() + s * point;
      const int64_t left = std::max<int64_t>(cell[2] - reach, 0);
      const int64_t right = std::min<int64_t>(cell[2] + reach, columns - 1);
      int64_t taken = 0;
      for (size_t line = 0; line < lines.size() && taken < s && left <= right; line += 2) {
        const int64_t z = cell[0] + lines[line], y = cell[1] + lines[line + 1];
        if (z < 0 || z >= planes || y < 0 || y >= rows) continue;
        const int64_t start = (z * rows + y) * columns;
        const int32_t* const end = key + begin[z * rows + y + 1];
        const int32_t* site = std::lower_bound(key + begin[z * rows + y], end, start + left);
        const float off_z = xyz[2] - ((static_cast<float>(z) + 0.5f) * size[2] + corner[2]);
        const float off_y = xyz[1] - ((static_cast<float>(y) + 0.5f) * size[1] + corner[1]);
        for (; site < end && *site <= start + right && taken < s; ++site) {
          const float off_x = xyz[0] - ((static_cast<float>(*site - start) + 0.5f) * size[0] + corner[0]);
          if (off_x * off_x + off_y * off_y + off_z * off_z <= radius_squared) {
            found[taken++] = static_cast<int32_t>(site - key);
          }
        }
      }
      number->typed_data()[point] = static_cast<int32_t>(taken);
      std::fill(found + taken, found + s, taken > 0 ? found[0] : 0);
    }
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(jaxsim_query, Query,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Integers>()
                                  .Arg<Floats>()
                                  .Arg<Integers>()
                                  .Attr<Numbers>("shape")
                                  .Attr<Numbers>("lines")
                                  .Attr<int64_t>("reach")
                                  .Attr<float>("radius_squared")
                                  .Attr<ffi::Span<const float>>("size")
                                  .Attr<ffi::Span<const float>>("corner")
                                  .Ret<Integers>()
                                  .Ret<Integers>());
