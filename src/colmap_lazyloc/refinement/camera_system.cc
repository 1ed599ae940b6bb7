#include "colmap_lazyloc/refinement/camera_system.h"

#include <numeric>

#include "colmap_lazyloc/math/selected_inverse.h"

namespace lazyloc {

template <int kSize>
void CameraSystem<kSize>::AddPoint(const std::vector<int>& frames) {
  if (IsDense()) return;
  for (const int a : frames) {
    std::vector<int>& columns = columns_of_row_[a];
    for (const int b : frames) {
      if (b > a) break;
      const auto at = std::lower_bound(columns.begin(), columns.end(), b);
      if (at == columns.end() || *at != b) columns.insert(at, b);
    }
  }
}

template <int kSize>
void CameraSystem<kSize>::Finish() {
  for (size_t row = 0; row < columns_of_row_.size() && IsDense(); ++row) {
    columns_of_row_[row].resize(row + 1);
    std::iota(columns_of_row_[row].begin(), columns_of_row_[row].end(), 0);
  }
  for (size_t row = 0; row < columns_of_row_.size(); ++row) {
    std::vector<int>& columns = columns_of_row_[row];
    if (columns.empty() || columns.back() != static_cast<int>(row)) columns.push_back(static_cast<int>(row));
    first_block_of_row_.push_back(num_blocks_);
    num_blocks_ += columns.size();
  }
}

template <int kSize>
bool CameraSystem<kSize>::Factorize(const Blocks& blocks) {
  if (IsDense()) {
    dense_.compute(Dense(blocks));
    return dense_.info() == Eigen::Success;
  }
  const Eigen::SparseMatrix<double> matrix = Sparse(blocks);
  if (!is_analyzed_) sparse_.analyzePattern(matrix);
  is_analyzed_ = true;
  sparse_.factorize(matrix);
  return sparse_.info() == Eigen::Success;
}

template <int kSize>
Eigen::VectorXd CameraSystem<kSize>::Solve(const Eigen::VectorXd& rhs) const {
  return IsDense() ? Eigen::VectorXd(dense_.solve(rhs)) : Eigen::VectorXd(sparse_.solve(rhs));
}

template <int kSize>
Eigen::MatrixXd CameraSystem<kSize>::ColumnsOfInverse(int frame) const {
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(kSize * NumFrames(), kSize);
  columns.template middleRows<kSize>(kSize * frame).setIdentity();
  return IsDense() ? Eigen::MatrixXd(dense_.solve(columns)) : Eigen::MatrixXd(sparse_.solve(columns));
}

template <int kSize>
Eigen::MatrixXd CameraSystem<kSize>::EquationsOf(const std::vector<int>& frames, const Blocks& blocks) const {
  const auto size = static_cast<Eigen::Index>(kSize * frames.size());
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
  for (size_t a = 0; a < frames.size(); ++a) {
    for (size_t b = 0; b <= a; ++b) {
      const bool is_lower = frames[b] <= frames[a];
      const Matrix* block = FindBlock(std::max(frames[a], frames[b]), std::min(frames[a], frames[b]), blocks);
      if (block == nullptr) continue;
      auto target = matrix.template block<kSize, kSize>(kSize * a, kSize * b);
      if (is_lower) {
        target = *block;
      } else {
        target = block->transpose();
      }
    }
  }
  return matrix;
}

template <int kSize>
std::vector<typename CameraSystem<kSize>::Matrix> CameraSystem<kSize>::DiagonalOfInverse() const {
  if (!IsDense()) return DiagonalOfSparseInverse();
  std::vector<Matrix> diagonal(columns_of_row_.size());
  const Eigen::Index size = kSize * NumFrames();
  const Eigen::MatrixXd root = dense_.matrixL().solve(Eigen::MatrixXd::Identity(size, size));  // inverse: root^T root
  for (size_t a = 0; a < diagonal.size(); ++a) {
    const auto columns = root.template middleCols<kSize>(kSize * a);
    diagonal[a] = columns.transpose() * columns;
  }
  return diagonal;
}

template <int kSize>
Eigen::MatrixXd CameraSystem<kSize>::Dense(const Blocks& blocks) const {
  Eigen::MatrixXd matrix(kSize * NumFrames(), kSize * NumFrames());
  size_t block = 0;
  for (size_t a = 0; a < columns_of_row_.size(); ++a) {
    for (const int b : columns_of_row_[a]) {
      matrix.template block<kSize, kSize>(kSize * a, kSize * b) = blocks[block++];
    }
  }
  return matrix;
}

template <int kSize>
Eigen::SparseMatrix<double> CameraSystem<kSize>::Sparse(const Blocks& blocks) const {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(kSize * kSize * num_blocks_);
  size_t block = 0;
  for (size_t a = 0; a < columns_of_row_.size(); ++a) {
    for (const int b : columns_of_row_[a]) {
      for (int col = 0; col < kSize; ++col) {
        for (int row = static_cast<int>(a) == b ? col : 0; row < kSize; ++row) {
          entries.emplace_back(kSize * a + row, kSize * b + col, blocks[block](row, col));
        }
      }
      ++block;
    }
  }
  Eigen::SparseMatrix<double> matrix(kSize * NumFrames(), kSize * NumFrames());
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

template <int kSize>
std::vector<typename CameraSystem<kSize>::Matrix> CameraSystem<kSize>::DiagonalOfSparseInverse() const {
  const Eigen::SparseMatrix<double> inverse = SelectedInverse(sparse_.matrixL());
  const auto& permuted = sparse_.permutationP().indices();
  std::vector<Matrix> diagonal(columns_of_row_.size());
  for (size_t a = 0; a < diagonal.size(); ++a) {
    for (int row = 0; row < kSize; ++row) {
      for (int col = 0; col < kSize; ++col) {
        const auto [low, high] = std::minmax(permuted[kSize * a + row], permuted[kSize * a + col]);
        diagonal[a](row, col) = inverse.coeff(high, low);
      }
    }
  }
  return diagonal;
}

template class CameraSystem<6>;
template class CameraSystem<7>;

}  // namespace lazyloc
