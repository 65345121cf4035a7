-- Who may ask what. A token itself is nowhere stored: whoever reads this file cannot use it.
create table tokens (
    token integer primary key,
    -- For people, and to revoke it by.
    name text not null unique,
    -- blake3 of the token, which is 32 random bytes: nothing to guess, so no salt and no slow hash.
    hash blob not null unique check (length(hash) = 32),
    -- What it allows: some of `read submit worker admin`, with spaces between.
    scopes text not null,
    created_ms integer not null,
    -- From then on it allows nothing. The row stays, so that its name tells who it was.
    revoked_ms integer
) strict;
