/* Lets the n-th write, rename, fsync or read below a folder fail, in a process that loads it first.

   faults_arm(folder, kind, n, stays) begins to count; with n = 0 nothing fails. faults_count(kind) tells. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { WRITE, RENAME, FSYNC, READ, KINDS };

static const int ERRORS[KINDS] = {ENOSPC, EIO, EIO, EIO};
static char root[PATH_MAX];
static size_t length;
static int armed_kind, remains;
static long wanted, counts[KINDS];

void faults_arm(const char *folder, int kind, long n, int stays) {
  memset(counts, 0, sizeof counts);
  armed_kind = kind;
  wanted = n;
  remains = stays;
  snprintf(root, sizeof root, "%s", folder);
  length = strlen(root);
}

long faults_count(int kind) { return counts[kind]; }

static int fails(int kind) {
  long n = __atomic_add_fetch(&counts[kind], 1, __ATOMIC_SEQ_CST);
  if (!wanted || kind != armed_kind || (remains ? n < wanted : n != wanted)) return 0;
  errno = ERRORS[kind];
  return 1;
}

static int below_path(const char *path) { return length && !strncmp(path, root, length); }

static int below(int fd) {
  char link[64], path[PATH_MAX];
  if (!length) return 0;
  snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(link, path, sizeof path - 1);
  if (n < 0) return 0;
  path[n] = 0;
  return below_path(path);
}

/* The function of the system that a function here stands before. */
#define REAL(name)                        \
  static __typeof__(&name) real;          \
  if (!real) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)
#define OF_FD(kind, result, name, declared, given)        \
  result name declared {                                  \
    REAL(name);                                           \
    return below(fd) && fails(kind) ? -1 : real given;    \
  }

OF_FD(WRITE, ssize_t, write, (int fd, const void *from, size_t n), (fd, from, n))
OF_FD(WRITE, ssize_t, pwrite, (int fd, const void *from, size_t n, off_t at), (fd, from, n, at))
OF_FD(WRITE, ssize_t, pwrite64, (int fd, const void *from, size_t n, off64_t at), (fd, from, n, at))
OF_FD(WRITE, ssize_t, writev, (int fd, const struct iovec *from, int n), (fd, from, n))
OF_FD(READ, ssize_t, read, (int fd, void *into, size_t n), (fd, into, n))
OF_FD(READ, ssize_t, pread, (int fd, void *into, size_t n, off_t at), (fd, into, n, at))
OF_FD(READ, ssize_t, pread64, (int fd, void *into, size_t n, off64_t at), (fd, into, n, at))
OF_FD(FSYNC, int, fsync, (int fd), (fd))
OF_FD(FSYNC, int, fdatasync, (int fd), (fd))

size_t fwrite(const void *from, size_t size, size_t n, FILE *file) {
  REAL(fwrite);
  return below(fileno(file)) && fails(WRITE) ? 0 : real(from, size, n, file);
}

size_t fread(void *into, size_t size, size_t n, FILE *file) {
  REAL(fread);
  return below(fileno(file)) && fails(READ) ? 0 : real(into, size, n, file);
}

int rename(const char *old, const char *name) {
  REAL(rename);
  return below_path(name) && fails(RENAME) ? -1 : real(old, name);
}

int renameat(int from, const char *old, int to, const char *name) {
  REAL(renameat);
  return below_path(name) && fails(RENAME) ? -1 : real(from, old, to, name);
}
